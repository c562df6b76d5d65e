"""The ManiSkill evaluator: environment, robots, rendering."""

import os

# Before SAPIEN loads a driver: with vectors of 128 bits, lavapipe 25.0 crashes on processors with AVX-512.
if os.environ.get("LP_NATIVE_VECTOR_WIDTH") == "128":
    os.environ.setdefault("GALLIUM_OVERRIDE_CPU_CAPS", "avx")
