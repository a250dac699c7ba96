# Fraction of the variance that each component explains. T[1]: components that the model keeps, 0 for all.
# Columns: variance of a component. The first 30 are drawn.
eval size(760, 500)
stats datafile index 1 using 1 nooutput
n = STATS_records < 30 ? STATS_records : 30
part(x) = STATS_sum > 0 ? x/STATS_sum : 0
sum = 0
set xlabel 'component'
set ylabel 'part of the variance'
set xrange [0.3:n + 0.7]
set yrange [0:1.05]
set boxwidth 0.7
set key center right
if (0 < V(1) && V(1) <= n) { set arrow from V(1) + 0.5,0 to V(1) + 0.5,1.05 nohead dt 2 lc rgb '#777777' }
plot datafile index 1 every ::::n - 1 using ($0 + 1):(part($1)) with boxes fs solid 0.6 lc rgb colour(1) title 'each', \
    datafile index 1 every ::::n - 1 using ($0 + 1):(sum = sum + part($1)) with linespoints pt 7 ps 0.6 lw 1.5 lc rgb colour(2) title 'running sum'
