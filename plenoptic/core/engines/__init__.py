"""Engines that run the jobs of a render: threads of this process, or workers of a cluster."""
