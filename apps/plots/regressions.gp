# Regression lines of windows, and beside them their intercepts and slopes.
# T[1]: classes; then their names. Columns: class (1, 2, ...), intercept, slope, ends of the line.
m = int(V(1))
eval size(1240, 560)
of(c, x) = column(1) == c ? x : NaN
set multiplot layout 1,2
set key left top
set xlabel 'standard deviation of the acceleration'
set ylabel 'standard deviation of the moment'
plot for [c = 1:m] datafile index 1 using (of(c, $4)):($2 + $3*$4):($5 - $4):($3*($5 - $4)) \
    with vectors nohead lw 0.6 lc rgb colour(c) title T[1 + c] noenhanced
set xlabel 'intercept'
set ylabel 'slope'
plot for [c = 1:m] datafile index 1 using (of(c, $2)):3 with points pt 7 ps 0.3 lc rgb colour(c) title T[1 + c] noenhanced
