"""Disparity by matching: four steps on one record, `ImageStack`, each of which another function can replace."""
