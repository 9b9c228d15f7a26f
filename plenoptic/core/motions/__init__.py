"""Poses and motions: rotations, rigid transforms, and rigid motions in time."""
