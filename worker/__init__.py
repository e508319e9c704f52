"""The bridge between the service's queue and the solver."""
