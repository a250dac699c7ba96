# Error against time of training. T[1]: 1 with several numbers of substeps, T[2]: number of integrators, T[3]: number of values of M; then the names of the
# integrators and the texts of M. Block (i - 1) V(3) + m: integrator i with value m. Columns: seconds, E1, substeps; an empty line begins each curve.
# circle, square, triangle up, triangle down, diamond, pentagon, all filled
mark(m) = int(word('7 5 9 11 13 15', (m - 1) % 6 + 1))
block(i, m) = (i - 1) * V(3) + m
eval size(900, 600)
set logscale xy
set format y '10^{%L}'
set xlabel 'seconds of training'.(V(1) == 1 ? ' (numbers: substeps)' : '')
set ylabel 'E1'
set key outside top center horizontal
set offsets graph 0.04, graph 0.04, 0, 0
plot for [i = 1:V(2)] for [m = 1:V(3)] datafile index block(i, m) using 1:2 with linespoints lw 1 lc rgb colour(i) pt mark(m) ps 0.8 notitle, \
    for [i = 1:V(1) == 1 ? V(2) : 0] for [m = 1:V(3)] datafile index block(i, m) using 1:2:3 with labels offset 0.9,0.5 font ',9' tc rgb colour(i) notitle, \
    for [i = 1:V(2)] keyentry with linespoints lw 1 lc rgb colour(i) pt mark(1) ps 0.8 title T[3 + i] noenhanced, \
    for [m = 1:V(3)] keyentry with points pt mark(m) ps 0.8 lc rgb '#333333' title T[3 + V(2) + m] noenhanced
