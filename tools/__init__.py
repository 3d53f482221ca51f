"""What keeps the project's own data up to date; not part of the package."""
