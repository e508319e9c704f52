"""The HTTP side: routes, what they take and give, and how refusals look."""
