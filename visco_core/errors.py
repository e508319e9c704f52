"""What can go wrong, as one tree.

VisCoError
├── InputError      the scan, a file or a setting cannot be used as it is
├── ResourceError   memory or time does not suffice for what was asked
├── SolveError      the solver met numbers that it cannot continue from
└── Stopped         the caller's ``should_stop`` said so
"""


class VisCoError(Exception):
    """Base of every error that the core raises on purpose.

    ``code`` is stable and meant for programs; ``str(error)`` is one sentence for people and says
    what to do.
    """

    def __init__(self, code: str, detail: str) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail

    def __reduce__(self) -> tuple[type["VisCoError"], tuple[str, str]]:
        return type(self), (self.code, self.detail)


class InputError(VisCoError):
    """The scan, a file or a setting cannot be used as it is."""


class ResourceError(VisCoError):
    """Memory or time does not suffice for what was asked."""


class SolveError(VisCoError):
    """The solver met numbers that it cannot continue from."""


class Stopped(VisCoError):
    """The caller's ``should_stop`` returned true; nothing was produced."""

    def __init__(
        self,
        code: str = "stopped",
        detail: str = "The reconstruction was stopped before it finished.",
    ) -> None:
        super().__init__(code, detail)
