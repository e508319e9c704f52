"""The service's sub-commands of `visco`: a module each, with ``add_arguments`` and ``run``."""
