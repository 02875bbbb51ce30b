"""The executables: read the arguments, call one room, print. One file each, with a ``main``; this is the top floor."""
