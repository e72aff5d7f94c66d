"""What an annotator would draw in a frame, proposed from the solved layout: correct it instead of drawing it."""
