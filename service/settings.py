"""Every setting of the service, read from ``VISCO_*`` environment variables.

A bad value stops start-up with one sentence. The same settings are read by the API, the worker
and the supervisor, so that a machine is configured in one place.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

from pydantic import Field, SecretStr, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

DeviceClass = Literal["cpu", "cuda"]
DEVICE_CLASSES: tuple[DeviceClass, ...] = get_args(DeviceClass)

# A unix socket's path may have 107 bytes; a data folder deep in a home can exceed it.
_LONGEST_SOCKET_PATH = 100
LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "::1")
# What the addresses of other programs begin with.
_SCHEMES = {
    "database_url": ("postgresql://", "postgresql+psycopg://", "postgres://", "sqlite:///"),
    "redis_url": ("redis://", "rediss://", "unix://"),
    "storage_url": ("s3://",),
    "s3_endpoint_url": ("http://", "https://"),
}


def default_data_dir() -> Path:
    """The folder for database, scans and results when no other is named."""
    base = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(base) / "visco"


class Settings(BaseSettings):
    """What an operator may set; ``docs/operations.md`` lists every field."""

    model_config = SettingsConfigDict(env_prefix="VISCO_", extra="ignore", frozen=True)

    host: str = Field("127.0.0.1", description="Address that the API listens on.")
    port: int = Field(8000, ge=0, le=65535, description="Port that the API listens on.")
    data_dir: Path = Field(
        default_factory=default_data_dir,
        description="Folder of the SQLite database, the local storage and the embedded broker.",
    )
    database_url: str = Field(
        "", description="SQLAlchemy address of the database; empty is SQLite in data_dir."
    )
    redis_url: str = Field(
        "", description="Address of Redis or Valkey; empty is the embedded one of `visco serve`."
    )
    storage_url: str = Field(
        "", description="s3://bucket/prefix for object storage; empty is a folder in data_dir."
    )
    s3_endpoint_url: str = Field("", description="Endpoint of an S3-compatible server.")
    storage_reserve_bytes: int = Field(
        1 << 28, ge=0, description="Free disk space that uploads never use up."
    )

    require_keys: bool | None = Field(
        None, description="Whether calls need an API key; unset: only away from loopback."
    )
    trusted_hosts: tuple[str, ...] = Field(
        (), description="Further Host names accepted while no key is needed."
    )

    max_upload_bytes: int = Field(2 << 30, ge=1, description="Largest scan file accepted.")
    max_points: int = Field(50_000_000, ge=1, description="Most points a scan may declare.")
    upload_lifetime_seconds: float = Field(
        86_400, gt=0, description="How long an upload that no job uses is kept."
    )
    retention_seconds: float = Field(
        30 * 86_400, gt=0, description="How long a finished job and its bytes are kept."
    )
    idempotency_seconds: float = Field(
        86_400, gt=0, description="How long an Idempotency-Key is remembered."
    )
    quota_queued: int = Field(1000, ge=0, description="Most queued jobs an owner; 0: no limit.")
    quota_running: int = Field(0, ge=0, description="Most running jobs an owner; 0: no limit.")
    quota_bytes: int = Field(0, ge=0, description="Most stored bytes an owner; 0: no limit.")
    rate_limit_per_minute: int = Field(
        1200, ge=0, description="Most calls a minute of one key or address; 0: no limit."
    )

    lease_seconds: float = Field(
        12, gt=0, description="An attempt without heartbeat for this long is lost."
    )
    heartbeat_seconds: float = Field(2, gt=0, description="Time between heartbeats.")
    reap_seconds: float = Field(2, gt=0, description="Time between looks for lost attempts.")
    max_lost_attempts: int = Field(3, ge=1, description="Lost attempts until a job fails.")
    hard_limit_seconds: float = Field(
        4 * 3600, gt=0, description="Longest attempt of a job without a time budget."
    )
    worker_memory_bytes: int = Field(
        0, ge=0, description="Memory limit of a solve; 0: most of what is free when it starts."
    )
    worker_threads: int = Field(0, ge=0, description="Threads of a solve; 0: the core decides.")

    webhook_secret: SecretStr = Field(
        SecretStr(""), description="whsec_… signing secret of webhooks; empty: made and stored."
    )
    webhook_allow_private: bool = Field(
        False, description="Whether webhooks may call private and loopback addresses."
    )
    log_format: Literal["text", "json"] = Field("text", description="Form of the log lines.")
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="Lowest level that is logged."
    )

    @field_validator("data_dir")
    @classmethod
    def _absolute(cls, value: Path) -> Path:
        return value.expanduser().resolve()

    @field_validator(*_SCHEMES)
    @classmethod
    def _known_scheme(cls, value: str, info: ValidationInfo) -> str:
        schemes = _SCHEMES[str(info.field_name)]
        if value and not value.startswith(schemes):
            raise ValueError(f"The address must begin with {' or '.join(schemes)}")
        return value

    @property
    def sqlalchemy_url(self) -> str:
        return self.database_url or f"sqlite:///{self.data_dir / 'visco.db'}"

    @cached_property
    def broker_socket(self) -> Path:
        """Unix socket of the embedded broker; the same for every process of one data_dir."""
        socket = self.data_dir / "run" / "valkey.sock"
        if len(os.fsencode(socket)) <= _LONGEST_SOCKET_PATH:
            return socket
        digest = hashlib.sha256(os.fsencode(self.data_dir)).hexdigest()[:16]
        return Path(tempfile.gettempdir()) / f"visco-{os.getuid()}-{digest}" / "valkey.sock"

    @property
    def redis_address(self) -> str:
        """Where redis-py connects."""
        return self.redis_url or f"unix://{self.broker_socket}"

    @property
    def celery_broker_url(self) -> str:
        """Where kombu connects; it names unix sockets in a way of its own."""
        address = self.redis_address
        return address.replace("unix://", "redis+socket://", 1)

    @property
    def listens_on_loopback(self) -> bool:
        return self.host in LOOPBACK_HOSTS

    @property
    def keys_needed(self) -> bool:
        return not self.listens_on_loopback if self.require_keys is None else self.require_keys

    def environment(self) -> dict[str, str]:
        """The settings that differ from the defaults as variables, for a child process."""
        changed = {}
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if field.default_factory is None and value == field.default:
                continue
            changed[f"VISCO_{name.upper()}"] = _as_variable(value)
        return changed


def _as_variable(value: object) -> str:
    if isinstance(value, SecretStr):
        return value.get_secret_value()
    if isinstance(value, tuple):
        return "[" + ",".join(f'"{item}"' for item in value) + "]"
    return str(value)


def _sentence(message: str) -> str:
    return f"{message.removeprefix('Value error, ')}."


def load_settings(**overrides: object) -> Settings:
    """Settings from the environment; ``overrides`` that are not None win.

    Raises SystemExit after a sentence for each bad field, so that a wrong setting stops start-up.
    """
    from pydantic import ValidationError

    try:
        return Settings(**{k: v for k, v in overrides.items() if v is not None})  # type: ignore[arg-type]
    except ValidationError as error:
        lines = [
            f"visco: VISCO_{'_'.join(map(str, item['loc'])).upper()}: {_sentence(item['msg'])}"
            for item in error.errors()
        ]
        print("\n".join(lines), file=sys.stderr)
        raise SystemExit(2) from None
