# Predicted against true values, a panel for each column. T[1]: panels, T[2]: size of a point; then for each panel its title and
# the ends of its axes. index 1, 2, ...: a panel (true, predicted).
set multiplot layout 1,int(V(1))
set size square
set xlabel 'true'
set ylabel 'predicted'
do for [k = 1:V(1)] {
    set title T[3*k] noenhanced
    set xrange [V(3*k + 1):V(3*k + 2)]
    set yrange [V(3*k + 1):V(3*k + 2)]
    plot datafile index k using 1:2 with points pt 7 ps V(2) lc rgb colour(1) notitle, x with lines lc rgb colour(2) notitle
}
unset multiplot
