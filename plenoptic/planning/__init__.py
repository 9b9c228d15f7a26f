"""Planning: which stages a scene before a camera needs, which are left out, and why."""
