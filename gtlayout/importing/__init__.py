"""From a video, a folder of images or a foreign scene to a scene folder in the native form."""
