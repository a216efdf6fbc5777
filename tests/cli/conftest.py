"""Fixtures of the engine."""

from engine.fixtures import cache, kit, store

__all__ = ["cache", "kit", "store"]
