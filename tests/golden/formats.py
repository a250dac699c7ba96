"""Writes a CSV table of numbers in another format: formats.py FILE.csv OUT

OUT ends in .npy (an array), .h5 (a data set for each column), .rec.h5 (one data set of records) or .dates.csv (the times t
as dates with times of day)."""
import datetime
import sys

import h5py
import numpy


def main():
    path, out = sys.argv[1:]
    table = numpy.genfromtxt(path, delimiter=',', names=True, deletechars='')
    if out.endswith('.npy'):
        numpy.save(out, numpy.array(table.tolist()))
    elif out.endswith('.h5'):
        with h5py.File(out, 'w') as file:
            if out.endswith('.rec.h5'):
                file['log'] = table
            else:
                for name in table.dtype.names:
                    file[name] = table[name]
    else:
        start = datetime.datetime(2024, 2, 28, 23, 59, 58)
        with open(out, 'w', encoding='ascii') as file:
            print(*table.dtype.names, sep=',', file=file)
            for row in table:
                time = (start + datetime.timedelta(seconds=row['t'])).isoformat(timespec='microseconds')
                print(*[time if name == 't' else repr(float(row[name])) for name in table.dtype.names], sep=',', file=file)


main()
