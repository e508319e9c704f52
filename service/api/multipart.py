"""Reading a submission while it arrives: the scan goes straight to a file, with its limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.concurrency import run_in_threadpool

from service.errors import ServiceError
from service.uploads.received import ReceivedFile, Receiver

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

_FIELD_BYTES = 1 << 18
_WRITE_BYTES = 1 << 20
_FIELDS = ("params", "upload_id")


@dataclass
class SubmissionForm:
    """The fields of a submission; ``file`` is the caller's to store or discard."""

    fields: dict[str, str] = field(default_factory=dict)
    file: ReceivedFile | None = None


class SubmissionReader:
    """Parses one multipart body. ``open_file`` makes the receiver of a file's bytes."""

    def __init__(self, request: Request, open_file: Callable[[str], Receiver]) -> None:
        self.request = request
        self.open_file = open_file
        self.form = SubmissionForm()
        self._receiver: Receiver | None = None
        self._header = b""
        self._headers: dict[bytes, bytes] = {}
        self._value = b""
        self._name = ""
        self._text = bytearray()
        self._pending = bytearray()
        self._in_file = False
        self._ended = False

    async def read(self) -> SubmissionForm:
        """Raises ServiceError (``bad_request``, ``too_large``, ``not_a_point_cloud``, …)."""
        parser = MultipartParser(self._boundary(), self._callbacks())
        try:
            async for chunk in self.request.stream():
                parser.write(chunk)
                if len(self._pending) >= _WRITE_BYTES:
                    await run_in_threadpool(self._flush)
            parser.finalize()
            await run_in_threadpool(self._flush)
            if not self._ended:
                raise ServiceError("bad_request", "The body ends before its closing boundary.")
            if self._receiver is not None:
                self.form.file = self._receiver.keep()
        except FormParserError as error:
            raise ServiceError("bad_request", f"The multipart body is broken: {error}.") from None
        finally:
            if self._receiver is not None:
                self._receiver.__exit__()
        return self.form

    def _boundary(self) -> bytes:
        kind, options = parse_options_header(self.request.headers.get("content-type"))
        if kind != b"multipart/form-data":
            raise ServiceError(
                "unsupported_media_type",
                "Send multipart/form-data with 'file' or 'upload_id', and 'params'.",
            )
        if not options.get(b"boundary"):
            raise ServiceError("bad_request", "The Content-Type names no boundary.")
        return options[b"boundary"]

    def _callbacks(self) -> MultipartCallbacks:
        return {
            "on_part_begin": self._part_begin,
            "on_header_field": self._header_field,
            "on_header_value": self._header_value,
            "on_header_end": self._header_end,
            "on_headers_finished": self._headers_finished,
            "on_part_data": self._part_data,
            "on_part_end": self._part_end,
            "on_end": self._end,
        }

    def _part_begin(self) -> None:
        self._headers, self._text, self._in_file = {}, bytearray(), False

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _header_end(self) -> None:
        self._headers[self._header.lower()] = self._value
        self._header = self._value = b""

    def _headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition"))
        self._name = options.get(b"name", b"").decode(errors="replace")
        if self._name == "file":
            if self._receiver is not None:
                raise ServiceError("bad_request", "Send one 'file' a job.")
            name = options.get(b"filename", b"").decode(errors="replace")
            self._receiver = self.open_file(name)
            self._in_file = True
        elif self._name not in _FIELDS or self._name in self.form.fields:
            raise ServiceError(
                "invalid_request", "Send 'file' or 'upload_id', and 'params', each once."
            )

    def _part_data(self, data: bytes, start: int, end: int) -> None:
        if self._in_file:
            self._pending += data[start:end]
            return
        self._text += data[start:end]
        if len(self._text) > _FIELD_BYTES:
            raise ServiceError("too_large", f"'{self._name}' may have {_FIELD_BYTES:,} bytes.")

    def _part_end(self) -> None:
        if not self._in_file:
            try:
                self.form.fields[self._name] = self._text.decode()
            except UnicodeDecodeError:
                raise ServiceError("bad_request", f"'{self._name}' must be UTF-8.") from None

    def _end(self) -> None:
        self._ended = True

    def _flush(self) -> None:
        if self._receiver is None or not self._pending:
            return
        self._receiver.write(bytes(self._pending))
        self._pending.clear()
