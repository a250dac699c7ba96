# Accuracy and size of pruned trees against alpha. T[1]: the model's alpha.
# Columns: alpha, accuracy on the training windows, on the tested ones, nodes, depth.
eval size(1240, 480)
stats datafile index 1 using 1 nooutput
set multiplot layout 1,2
set xlabel 'alpha'
set ylabel 'accuracy'
set key bottom left
# The last trees have a far larger alpha and would squeeze the others.
if (0 < V(1) && 12*V(1) < STATS_max) { set xrange [0:12*V(1)] }
set arrow from V(1), graph 0 to V(1), graph 1 nohead dt 2 lc rgb '#777777'
plot datafile index 1 using 1:2 with steps lw 2 lc rgb colour(1) title 'training', \
    datafile index 1 using 1:3 with steps lw 2 lc rgb colour(2) title 'test'
set ylabel 'nodes'
set logscale y
set y2label 'depth'
set y2tics
set ytics nomirror
set key top right
plot datafile index 1 using 1:4 with steps lw 2 lc rgb colour(1) title 'nodes', \
    datafile index 1 using 1:5 axes x1y2 with steps lw 1.5 dt 2 lc rgb colour(3) title 'depth'
