# Objective against the number of a trial. T[1]: trials. Columns: trial, 1 if it was finished, 1 if it was stopped, objective.
eval size(800, 500)
objective(k) = column(k) > 0 ? finite(4, NaN) : NaN
best = 1e300
stats datafile index 1 using ($3 > 0 && finite(4, 0) > 0) nooutput
stopped = STATS_sum
stats datafile index 1 using ($2 > 0 && finite(4, 0) > 0) nooutput
finished = STATS_sum
eval powers('y')
set xlabel 'trial'
set ylabel 'objective'
set xrange [-1:V(1)]
if (stopped + finished == 0) { set yrange [1e-6:1] }
set key top right
plot 1/0 notitle, \
    datafile index 1 using 1:(objective(3)) with points pt 2 lc rgb '#999999' title stopped > 0 ? 'stopped early' : '', \
    datafile index 1 using 1:(objective(2)) with points pt 7 lc rgb '#1f5fa8' title finished > 0 ? 'finished' : '', \
    datafile index 1 using 1:(best = objective(2) < best ? $4 : best, best < 1e300 ? best : NaN) with steps lw 2 lc rgb '#d1641f' title finished > 0 ? 'best so far' : ''
