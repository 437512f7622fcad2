"""The most memory that a process of its own took."""

# VmHWM is that of the program itself. ``ru_maxrss`` of a new program begins with the memory of the one that started it.
PRINT_MOST_KIB = "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
