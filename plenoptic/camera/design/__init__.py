"""Set-up of a camera by wishes."""
