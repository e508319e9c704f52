"""Where the bytes of scans and results lie: a folder, or an S3-compatible store."""

from service.storage.base import Storage, StorageFull, StoredBytesMissing, open_storage

__all__ = ["Storage", "StorageFull", "StoredBytesMissing", "open_storage"]
