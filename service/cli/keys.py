"""Make, list and revoke API keys; show the secret that signs webhooks."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from service.cli.common import add_data_argument
from visco_core.errors import InputError

if TYPE_CHECKING:
    from service.auth.service import KeyService


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_data_argument(parser)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    create = actions.add_parser("create", help="make a key; it is shown once")
    create.add_argument("name", nargs="?", default="key", help="what the key is for")
    create.add_argument("--owner", default="local", help="whose jobs the key sees (local)")
    create.add_argument(
        "--scope",
        action="append",
        choices=("read", "write", "admin"),
        help="what the key may do (repeatable; read and write if left out)",
    )
    listed = actions.add_parser("list", help="show all keys, without their secrets")
    revoke = actions.add_parser("revoke", help="make a key useless")
    revoke.add_argument("id", help="the key's id, as `visco keys list` shows it")
    secret = actions.add_parser("webhook-secret", help="show the secret that receivers check with")
    for action in (create, listed, revoke, secret):
        # Also behind the action; one that stands before it must not be forgotten there.
        add_data_argument(action, default=argparse.SUPPRESS)


def run(args: argparse.Namespace) -> int:
    from service.auth.service import KeyService
    from service.db.migrate import open_database
    from service.settings import load_settings
    from service.webhooks.signature import shared_secret

    settings = load_settings(data_dir=args.data_dir)
    database = open_database(settings.sqlalchemy_url)
    keys = KeyService(database)
    if args.action == "create":
        print(keys.create(args.name, args.owner, args.scope or ["read", "write"]).secret)
    elif args.action == "webhook-secret":
        print(shared_secret(database, settings))
    elif args.action == "revoke":
        if not keys.revoke(args.id):
            raise InputError(
                "unknown_key", f"There is no key {args.id}; `visco keys list` shows them."
            )
    else:
        _show(keys)
    return 0


def _show(keys: KeyService) -> None:
    found = keys.all()
    for key in found:
        state = "revoked" if key.revoked_at else "active"
        made = key.created_at.date()
        print(f"{key.id}  {state:7}  {key.owner:16}  {','.join(key.scopes):16}  {made}  {key.name}")
    if not found:
        print("There are no keys yet; `visco keys create NAME` makes one.", file=sys.stderr)
