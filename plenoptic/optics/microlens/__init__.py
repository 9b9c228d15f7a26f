"""The microlens array: lattice, openings, imperfections, dust, and the record that kernels read."""
