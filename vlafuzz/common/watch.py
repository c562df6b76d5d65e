"""Watch: follows long work. The command line draws progress bars with one; from Python none is needed."""


class Watch:
    """Ignores what it is told; override what is of interest.

    The methods are called by the process that called the work, but ``note`` also by its workers: it is static so that
    they can import it.
    """

    def progress(self, description: str, done: int, total: int | None) -> None:
        """``done`` of the ``total`` steps of a stage are finished; ``total`` is None where it is unknown."""

    @staticmethod
    def note(text: str) -> None:
        """Something happened that the user should know."""


SILENT = Watch()
