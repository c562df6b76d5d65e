"""The LIBERO world: suites of the LIBERO benchmark on robosuite and MuJoCo, by the extra ``libero``."""
