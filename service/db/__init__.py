"""The database: the only truth about jobs, uploads and keys."""

from service.db.base import Base, UtcDateTime, new_id, utc_now
from service.db.engine import Database, Transaction

__all__ = ["Base", "Database", "Transaction", "UtcDateTime", "new_id", "utc_now"]
