"""Writes trajectories whose layout is that of a family of Hamiltonians: families.py NAME FILE.h5

Bodies turn about their third axis with a constant momentum, directions turn about the first axis, and other coordinates
move with constant velocities: motions without forces, which any masses allow."""
import sys

import h5py
import numpy

N, M, DT = 6, 5, 0.02
PARTS = {'chain': 'q1 p1', 'rotation': 'R pi', 'rotation-direction': 'R pi q p', 'rotation-line': 'R pi x px',
         'pose': 'R pi x px', 'pose-direction': 'R pi q p x px', 'direction-line': 'q p x px', 'separable': 'q p'}


def parts(name, speed, t):
    """The numbers of each part of the state at the time t."""
    c, s = numpy.cos(speed * t), numpy.sin(speed * t)
    lines = 3 if name.startswith('pose') else 1
    line = [speed * t + i for i in range(lines)], [speed] * lines
    body = [c, -s, 0, s, c, 0, 0, 0, 1], [0, 0, speed]
    direction = [0, c, s], [0, -speed * s, speed * c]
    x = line if name in ('pose', 'pose-direction', 'rotation-line', 'direction-line', 'separable') else ([], [])
    R = body if name.startswith(('rotation', 'pose')) else ([], [])
    q = direction if 'direction' in name or name == 'chain' else ([], [])
    return numpy.concatenate(R + q + x)


def main():
    name, path = sys.argv[1:]
    times = DT * numpy.arange(M)
    with h5py.File(path, 'w') as file:
        file['t'] = times
        file['trajectories'] = [[parts(name, 1 + i / N, t + i) for t in times] for i in range(N)]
        file.attrs['layout'] = PARTS[name]


main()
