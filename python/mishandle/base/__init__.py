"""What every other package may use: files, time limits, hashes of code, pictures, scenes."""
