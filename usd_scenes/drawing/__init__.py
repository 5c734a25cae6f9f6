"""Drawing the figures of the documentation: sheets of captioned tiles, and lines over a picture."""
