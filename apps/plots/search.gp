# Objective against the number of a trial. T[1]: trials, T[2]: stopped ones, T[3]: finished ones.
# Columns: trial, objective. index 1: stopped trials, 2: finished ones, 3: the best so far; each block begins with a line of NaN.
set logscale y
set format y '10^{%L}'
set xlabel 'trial'
set ylabel 'objective'
set xrange [-1:V(1)]
if (V(2) + V(3) == 0) { set yrange [1e-6:1] }
set key top right
plot 1/0 notitle, \
    datafile index 1 with points pt 2 lc rgb '#999999' title V(2) > 0 ? 'stopped early' : '', \
    datafile index 2 with points pt 7 lc rgb '#1f5fa8' title V(3) > 0 ? 'finished' : '', \
    datafile index 3 with steps lw 2 lc rgb '#d1641f' title V(3) > 0 ? 'best so far' : ''
