"""An S3-compatible store; credentials come from the usual AWS variables or files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

from service.storage.base import CHUNK, StorageFull, StoredBytesMissing

_FULL = {"XMinioStorageFull", "QuotaExceeded", "InsufficientCapacity", "507"}
_MISSING = {"NoSuchKey", "404", "NotFound"}


class S3Storage:
    """Objects of one bucket below a prefix. Objects appear whole: S3 has no half-written ones."""

    def __init__(self, url: str, endpoint_url: str | None = None) -> None:
        import boto3
        from botocore.config import Config

        parsed = urlparse(url)
        if parsed.scheme != "s3" or not parsed.netloc:
            raise ValueError("the storage address must look like s3://bucket/prefix")
        self.bucket = parsed.netloc
        prefix = parsed.path.strip("/")
        self.prefix = f"{prefix}/" if prefix else ""
        config = Config(retries={"max_attempts": 5, "mode": "standard"})
        self.client: Any = boto3.client("s3", endpoint_url=endpoint_url, config=config)

    def put(self, key: str, source: Path) -> None:
        from boto3.exceptions import S3UploadFailedError
        from botocore.exceptions import ClientError

        try:
            self.client.upload_file(str(source), self.bucket, self.prefix + key)
        except (ClientError, S3UploadFailedError) as error:
            if any(code in str(error) for code in _FULL):
                raise StorageFull(str(error)) from error
            raise
        source.unlink()

    def read(self, key: str, start: int = 0, length: int | None = None) -> Iterator[bytes]:
        if length == 0:
            return iter(())
        last = "" if length is None else str(start + length - 1)
        # An empty object has no byte 0 and refuses every Range.
        wanted = {"Range": f"bytes={start}-{last}"} if start or last else {}
        with _missing(key):
            answer = self.client.get_object(Bucket=self.bucket, Key=self.prefix + key, **wanted)
        return answer["Body"].iter_chunks(CHUNK)

    def fetch(self, key: str, target: Path) -> None:
        with _missing(key):
            self.client.download_file(self.bucket, self.prefix + key, str(target))

    def delete(self, key: str) -> None:
        self.client.delete_object(Bucket=self.bucket, Key=self.prefix + key)

    def delete_all(self, prefix: str) -> None:
        pages = self.client.get_paginator("list_objects_v2")
        for page in pages.paginate(Bucket=self.bucket, Prefix=self.prefix + prefix):
            keys = [{"Key": item["Key"]} for item in page.get("Contents", ())]
            if keys:
                self.client.delete_objects(Bucket=self.bucket, Delete={"Objects": keys})

    def free_bytes(self) -> int | None:
        return None

    def check(self) -> None:
        self.client.head_bucket(Bucket=self.bucket)


class _missing:  # noqa: N801  reads as a statement
    """Turns the client's «no such key» into StoredBytesMissing."""

    def __init__(self, key: str) -> None:
        self.key = key

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        from botocore.exceptions import ClientError

        if isinstance(error, ClientError) and error.response["Error"]["Code"] in _MISSING:
            raise StoredBytesMissing(self.key) from None
