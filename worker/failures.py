"""From an exception to the code and the sentence that a failed job shows."""

from __future__ import annotations

from service.storage import StorageFull, StoredBytesMissing
from visco_core.errors import VisCoError

OUT_OF_MEMORY = "out_of_memory"


def is_out_of_memory(error: BaseException) -> bool:
    """Whether host or device memory ran out; torch is not imported to find out."""
    names = {kind.__name__ for kind in type(error).__mro__}
    if "MemoryError" in names or "OutOfMemoryError" in names:
        return True
    if isinstance(error, VisCoError):
        return error.code == OUT_OF_MEMORY
    words = ("can't allocate memory", "out of memory")
    return isinstance(error, RuntimeError) and any(word in str(error) for word in words)


def describe_failure(error: Exception) -> tuple[str, str]:
    """Code and advice. What is not foreseen says nothing of the machine's inside."""
    if isinstance(error, VisCoError):
        return error.code, error.detail
    if isinstance(error, StorageFull):
        return "storage_full", "Delete finished jobs or ask the operator for room, then retry."
    if isinstance(error, StoredBytesMissing) or type(error).__name__ == "InputLost":
        return "input_lost", "Submit the scan again: its stored bytes are missing or damaged."
    if is_out_of_memory(error):
        return OUT_OF_MEMORY, "Retry with a lower resolution or on a worker with more memory."
    return "internal_error", "Retry the job; if it fails again, report its id to the operator."


def hard_limit_failure(seconds: float) -> tuple[str, str]:
    """Code and advice for a solve that did not end by itself."""
    return (
        "hard_limit",
        f"The solve did not end within {seconds:.0f} s and was stopped; "
        "set budget_seconds or a lower resolution.",
    )
