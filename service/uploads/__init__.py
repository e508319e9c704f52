"""Uploads: the scans that jobs read, received at once or in resumable pieces."""
