"""Taking hold of a body: what moves it is not forces but places that are held, and tools."""

from surrogate.mechanics.touch.grip import Grip, GripFrame
from surrogate.mechanics.touch.touch import Touch, TouchFrame

__all__ = ["Grip", "GripFrame", "Touch", "TouchFrame"]
