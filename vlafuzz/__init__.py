"""vlafuzz finds scenes in which a vision-language-action policy fails.

What is imported from here is described in ``vlafuzz.api``, which is loaded when it is first used.
"""

__version__ = "0.1.0"
__all__ = ["__version__", "bisect", "demonstrate", "diff", "film", "fuzz", "open_store", "regress"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module("vlafuzz.api"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
