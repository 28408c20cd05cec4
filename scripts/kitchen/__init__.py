"""The bundled kitchen: its bodies and joints, in millimeters, and their serialization as a semantic map."""
