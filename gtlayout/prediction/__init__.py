"""What a camera must see of a layout, and which drawn element shows which instance of it."""
