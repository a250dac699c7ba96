"""The clocks of a training by JAX: since the process began, and without its start and compiling."""
import time

import jax


def since_start():
    """Seconds of the clock since the process began."""
    with open("/proc/self/stat") as file:
        ticks = float(file.read().rsplit(")", 1)[1].split()[19])
    with open("/proc/uptime") as file:
        return float(file.read().split()[0]) - ticks / 100  # of USER_HZ


class Clocks:
    def __init__(self):
        self.left_out = [since_start(), time.process_time()]  # the start, then all compiling

    def compiled(self, function, *example, **options):
        """The executable for such arguments; data are arguments, not constants to fold."""
        begin = time.perf_counter(), time.process_time()
        out = jax.jit(function, **options).lower(*example).compile()
        self.left_out[0] += time.perf_counter() - begin[0]
        self.left_out[1] += time.process_time() - begin[1]
        return out

    def told(self):
        wall, cpu = since_start(), time.process_time()
        return dict(seconds=wall, cpu=cpu, seconds_without=wall - self.left_out[0], cpu_without=cpu - self.left_out[1])
