"""Webhooks: telling a job's callback_url how it ended, signed by Standard Webhooks."""
