"""Media: dispersion formulas, catalogues, air."""
