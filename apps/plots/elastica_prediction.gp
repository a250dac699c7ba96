# A learned curve, with equal scales on both axes. T[1]: step of the tics of y, T[2]: 1 with the solution, else 0.
# Columns: x, y. index 1: the learned curve, 2: the solution, or NaN.
set xlabel 'x'
set ylabel 'y'
set size ratio -1
set ytics V(1)
set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05
set key top center horizontal outside
plot datafile index 2 with lines lw 2.5 lc rgb '#1f5fa8' title (V(2) > 0 ? 'solved' : ''), \
    datafile index 1 with linespoints pt 7 ps 0.5 lw 1 lc rgb '#d1641f' title 'learned'
