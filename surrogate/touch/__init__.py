"""Taking hold of a body: what moves it is not forces but places that are held."""

from surrogate.touch.grip import Grip, GripFrame

__all__ = ["Grip", "GripFrame"]
