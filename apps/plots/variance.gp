# Fraction of the variance that each component explains. T[1]: components, T[2]: those that the model keeps, 0 for all.
# Columns: component, its fraction, the sum of the fractions up to it.
set xlabel 'component'
set ylabel 'part of the variance'
set xrange [0.3:V(1) + 0.7]
set yrange [0:1.05]
set boxwidth 0.7
set key center right
if (0 < V(2) && V(2) <= V(1)) { set arrow from V(2) + 0.5,0 to V(2) + 0.5,1.05 nohead dt 2 lc rgb '#777777' }
plot datafile index 1 using 1:2 with boxes fs solid 0.6 lc rgb colour(1) title 'each', \
    datafile index 1 using 1:3 with linespoints pt 7 ps 0.6 lw 1.5 lc rgb colour(2) title 'running sum'
