"""Fixtures of the engine, for tasks on a cluster."""

from engine.fixtures import cache, kit, store

__all__ = ["cache", "kit", "store"]
