"""What the figures in docs/ are measured with: controllers and training in ``control``, the diagnosis in ``blind``."""
