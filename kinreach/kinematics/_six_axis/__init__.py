"""Six-axis arms of any make: closed forms by the geometry of the axes, and elimination for the others."""
