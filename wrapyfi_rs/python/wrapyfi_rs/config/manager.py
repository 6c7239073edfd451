"""Modes of methods from a file: ``{Class: {method: mode, or a list of modes by instance}}``."""


class _First(type):
    """Keeps the first configuration that is given; later ones are not read, as in Wrapyfi."""

    _made = None

    def __call__(cls, config=None, **_ignored):
        if cls._made is None or not cls._made.config:
            cls._made = super().__call__(config)
        return cls._made


class ConfigManager(metaclass=_First):
    """The configuration of the program, a path of a YAML file or a dict; to be made before the instances."""

    def __init__(self, config=None):
        self.config = self._load(config) if isinstance(config, str) else config or {}

    @staticmethod
    def _load(path):
        import yaml  # only a program with a file needs it

        with open(path, encoding="utf-8") as file:
            return yaml.safe_load(file) or {}
