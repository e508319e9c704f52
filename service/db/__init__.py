"""The database: the only truth about jobs, uploads and keys."""

from service.db.base import Base, UtcDateTime, new_id, utc_now
from service.db.engine import Database, Transaction, hold

__all__ = ["Base", "Database", "Transaction", "UtcDateTime", "hold", "new_id", "utc_now"]
