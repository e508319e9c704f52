"""Who calls: API keys, their scopes, and the owner that a call acts for."""
