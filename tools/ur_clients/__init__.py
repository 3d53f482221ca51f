"""Other people's clients of a UR, tried on `kinreach simulate-ur`: `make ur-clients`."""
