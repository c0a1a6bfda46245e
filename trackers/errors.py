"""The one error that means: the input is wrong, and here is what would be right."""


class InputError(ValueError):
    """Bad input from the user: one sentence naming the file, the field, the value and what would be valid.

    The command line prints it without a traceback and exits with code 2; every other exception is a fault of ours.
    """
