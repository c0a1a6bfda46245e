"""The errors that are the user's to mend: the input is wrong, or a tracker of their own is."""


class InputError(ValueError):
    """Bad input from the user: one sentence naming the file, the field, the value and what would be valid.

    The command line prints it without a traceback and exits with code 2; every other exception but a plug-in's is a fault
    of ours.
    """


class PlugInError(Exception):
    """A tracker of the user's own raised something: one sentence naming class, method, observation and line.

    The command line prints it without a traceback and exits with code 1: the input was good, the tracker fell short.
    """
