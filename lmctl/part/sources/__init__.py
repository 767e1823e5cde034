"""Where a part comes from: files of meshes and clouds, read and judged."""
