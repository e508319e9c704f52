"""Make, list and revoke API keys; show the secret that signs webhooks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data-dir", type=Path, help="folder of database, scans and results")
    actions = parser.add_subparsers(dest="action", required=True)
    create = actions.add_parser("create", help="make a key; it is shown once")
    create.add_argument("name", nargs="?", default="key", help="what the key is for")
    create.add_argument("--owner", default="local", help="whose jobs the key sees (local)")
    create.add_argument(
        "--scope", action="append", choices=("read", "write", "admin"), help="read and write"
    )
    actions.add_parser("list", help="show all keys, without their secrets")
    revoke = actions.add_parser("revoke", help="make a key useless")
    revoke.add_argument("id")
    actions.add_parser("webhook-secret", help="show the secret that receivers check with")


def run(args: argparse.Namespace) -> int:
    from service.auth.service import KeyService
    from service.db import Database
    from service.db.migrate import migrate
    from service.settings import load_settings
    from service.webhooks.signature import shared_secret

    settings = load_settings(data_dir=args.data_dir)
    database = Database(settings.sqlalchemy_url)
    migrate(database)
    keys = KeyService(database)
    if args.action == "create":
        new = keys.create(args.name, args.owner, args.scope or ["read", "write"])
        print(new.secret)
        return 0
    if args.action == "webhook-secret":
        print(shared_secret(database, settings))
        return 0
    if args.action == "revoke":
        if keys.revoke(args.id):
            return 0
        print(f"There is no key {args.id}; `visco keys list` shows them.", file=sys.stderr)
        return 2
    for key in keys.all():
        state = "revoked" if key.revoked_at else "active"
        made = key.created_at.date()
        print(f"{key.id}  {state:7}  {key.owner:16}  {','.join(key.scopes):16}  {made}  {key.name}")
    return 0
