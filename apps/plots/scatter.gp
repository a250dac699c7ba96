# Predicted against true values, a panel for each column. T[1]: rows of the table, then the title of each panel.
# Columns: the true values of all panels, then the predicted ones.
n = count - 1
eval size(460*n, 460)
set multiplot layout 1,n
set size square
set xlabel 'true'
set ylabel 'predicted'
do for [k = 1:n] {
    stats datafile index 1 using k:n + k nooutput
    low = STATS_min_x < STATS_min_y ? STATS_min_x : STATS_min_y
    high = STATS_max_x > STATS_max_y ? STATS_max_x : STATS_max_y
    room = high > low ? 0.04*(high - low) : 1
    set title T[1 + k] noenhanced
    set xrange [low - room:high + room]
    set yrange [low - room:high + room]
    plot datafile index 1 using k:n + k with points pt 7 ps (V(1) < 300 ? 0.8 : 0.4) lc rgb colour(1) notitle, x with lines lc rgb colour(2) notitle
}
unset multiplot
