"""A scene while it is annotated: solved again and again, with what has not changed kept."""
