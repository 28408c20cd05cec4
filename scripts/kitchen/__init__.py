"""The bundled kitchen: what stands in it and where, in millimetres, and the map that says so."""
