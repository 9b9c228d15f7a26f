"""What a lens does, computed: rays aimed at its iris, spots, fans, fields, contrast, third-order sums."""
