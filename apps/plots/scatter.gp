# Predicted against true values, a panel for each column. T[1]: rows of the table, then the title of each panel.
# Columns: the true values of all panels, then the predicted ones.
n = count - 1
eval size(460*n, 460)
set multiplot layout 1,n
set size square
set xlabel 'true'
set ylabel 'predicted'
do for [k = 1:n] {
    set autoscale # `stats` skips points outside the ranges of the panel before
    stats datafile index 1 using k nooutput
    low = STATS_min
    high = STATS_max
    stats datafile index 1 using (finite(n + k, low)) nooutput
    low = STATS_min < low ? STATS_min : low
    high = STATS_max > high ? STATS_max : high
    room = high > low ? 0.04*(high - low) : 1
    set title T[1 + k] noenhanced
    set xrange [low - room:high + room]
    set yrange [low - room:high + room]
    plot datafile index 1 using k:n + k with points pt 7 ps (V(1) < 300 ? 0.8 : 0.4) lc rgb colour(1) notitle, x with lines lc rgb colour(2) notitle
}
