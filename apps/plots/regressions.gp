# Regression lines of windows, and beside them their intercepts and slopes.
# T[1]: classes; then their names. index 1 to T[1]: the lines of a class (two points each). The others: intercepts and slopes.
m = int(V(1))
set multiplot layout 1,2
set key left top
set xlabel 'standard deviation of the acceleration'
set ylabel 'standard deviation of the moment'
plot for [c = 1:m] datafile index c using 1:2 with lines lw 0.6 lc rgb colour(c) title T[1 + c] noenhanced
set xlabel 'intercept'
set ylabel 'slope'
plot for [c = 1:m] datafile index m + c using 1:2 with points pt 7 ps 0.3 lc rgb colour(c) title T[1 + c] noenhanced
unset multiplot
