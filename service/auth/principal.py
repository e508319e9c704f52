"""Who a call acts for, and what it may do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from service.errors import ServiceError

Scope = Literal["read", "write", "admin"]
SCOPES: tuple[Scope, ...] = get_args(Scope)


@dataclass(frozen=True)
class Principal:
    """``read`` sees the owner's jobs, ``write`` makes and changes them, ``admin`` sees all."""

    owner: str
    scopes: frozenset[str]
    key_id: str | None = None

    @property
    def visible_owner(self) -> str | None:
        """The owner whose jobs the call sees; None is everyone's."""
        return None if "admin" in self.scopes else self.owner

    def require(self, scope: Scope) -> None:
        """Raises ServiceError ``forbidden`` unless the key has the scope."""
        if scope not in self.scopes and "admin" not in self.scopes:
            raise ServiceError("forbidden", f"Use an API key with the scope '{scope}'.")


LOCAL_USER = Principal("local", frozenset(SCOPES))
