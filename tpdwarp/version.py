"""The program's version, in a module of its own so that every room can import it without the package's public face."""

VERSION = "0.1.0"
