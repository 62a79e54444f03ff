"""Sizes of effects."""


class NotAttainable(Exception):
    """A draw gives no case: a flight diverges, or the effect does not reach the wanted size."""
