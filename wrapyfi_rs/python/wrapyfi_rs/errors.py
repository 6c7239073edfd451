"""Exceptions of the package. Each is also of the class that a script of Wrapyfi may catch."""


class WrapyfiError(Exception):
    """Any fault of a call."""


class ModeError(WrapyfiError, ValueError):
    """A mode that there is not, or that a method cannot have."""


class OptionError(WrapyfiError, ValueError):
    """An option of ``register`` with a value that means nothing."""


class OpenError(WrapyfiError, OSError):
    """An end that cannot be opened: its middleware does not start, or refuses the name."""


class ObjectError(WrapyfiError, TypeError, ValueError):
    """An object that has no form in a message."""


class ValueMismatch(WrapyfiError, ValueError):
    """An image or a sound that is not as the options say, or a message that is none of its type."""


class ReturnError(WrapyfiError, TypeError):
    """A method that does not return a tuple of the values it is registered for."""


class WaitTimeout(WrapyfiError, TimeoutError):
    """A wait that took longer than the option ``timeout_ms``."""


class CallError(WrapyfiError, RuntimeError):
    """A request without a reply: the server raised, or did not answer in time; the text says which."""


class EndedError(WrapyfiError, RuntimeError):
    """A wait that ended because the instance was closed."""


class InternalError(WrapyfiError, RuntimeError):
    """A fault of this package."""
