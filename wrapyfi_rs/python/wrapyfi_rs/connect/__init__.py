"""The decorator, in ``wrapper``, and what scripts ask of the ends that there are."""
