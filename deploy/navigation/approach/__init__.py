"""Navigation by the Moon's limb and by stars, from 400 000 km to 2000 km."""
