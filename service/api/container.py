"""The parts that the routes work with, built once a process."""

from __future__ import annotations

from dataclasses import dataclass

from service.auth.limits import RateLimiter
from service.auth.service import KeyService
from service.db import Database
from service.events import EventFeed
from service.jobs.queues import Bell
from service.jobs.service import JobService
from service.jobs.submission import JobIntake
from service.settings import Settings
from service.storage import Storage, open_storage
from service.uploads.service import UploadService


@dataclass(frozen=True)
class Services:
    """Nothing in here holds state that another API process would miss."""

    settings: Settings
    database: Database
    storage: Storage
    bell: Bell
    feed: EventFeed
    keys: KeyService
    limiter: RateLimiter
    intake: JobIntake
    jobs: JobService
    uploads: UploadService

    @classmethod
    def build(cls, settings: Settings) -> Services:
        database = Database(settings.sqlalchemy_url)
        storage = open_storage(settings)
        bell = Bell(settings)
        intake = JobIntake(database, bell, settings)
        return cls(
            settings=settings,
            database=database,
            storage=storage,
            bell=bell,
            feed=EventFeed(database, settings),
            keys=KeyService(database),
            limiter=RateLimiter(bell, settings.rate_limit_per_minute),
            intake=intake,
            jobs=JobService(database, storage, bell, intake),
            uploads=UploadService(database, storage, settings),
        )

    def close(self) -> None:
        self.bell.close()
        self.database.dispose()
