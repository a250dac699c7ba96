# Objective against the number of a trial. T[1]: trials. Columns: trial, objective if it was stopped, if it was finished, the best so far; the others are NaN.
eval size(800, 500)
stats datafile index 1 using (finite(2, 0) > 0) nooutput
stopped = STATS_sum
stats datafile index 1 using (finite(3, 0) > 0) nooutput
finished = STATS_sum
eval powers('y')
set xlabel 'trial'
set ylabel 'objective'
set xrange [-1:V(1)]
if (stopped + finished == 0) { set yrange [1e-6:1] }
set key top right
plot 1/0 notitle, \
    datafile index 1 using 1:2 with points pt 2 lc rgb '#999999' title stopped > 0 ? 'stopped early' : '', \
    datafile index 1 using 1:3 with points pt 7 lc rgb '#1f5fa8' title finished > 0 ? 'finished' : '', \
    datafile index 1 using 1:4 with steps lw 2 lc rgb '#d1641f' title finished > 0 ? 'best so far' : ''
