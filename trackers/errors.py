"""Errors for the user to correct: wrong input, or a plug-in tracker that failed."""


class InputError(ValueError):
    """Wrong input: one sentence naming the file, the field, the value and what would be valid.

    The command line prints it without a traceback and exits with code 2; every other exception except a plug-in's is a bug
    of ours.
    """


class PlugInError(Exception):
    """Exception of a plug-in tracker: one sentence naming class, method, observation and line.

    The command line prints it without a traceback and exits with code 1: the input was valid.
    """
