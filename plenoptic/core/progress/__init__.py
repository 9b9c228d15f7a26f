"""Progress bars of long calls, and the state of compilation that they show."""
