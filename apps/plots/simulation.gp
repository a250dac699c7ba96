# Panels of a run. T[1]: number of panels. For each panel: its kind (components, phase, invariants, manifold, rounding, steps, many steps), title, label of x,
# label of y, number of curves, and the name of each curve; without a curve, the reason. Block k is panel k: x, and a column for each curve.
# All texts are of our own tables: symbols such as q_{2,x}.
set multiplot layout (V(1) + 1) / 2, V(1) > 1 ? 2 : 1
at = 1
do for [k = 1:V(1)] {
    kind = T[at + 1]
    curves = V(at + 5)
    set title T[at + 2]
    set xlabel T[at + 3]
    set ylabel T[at + 4]
    at = at + 5
    set autoscale
    set xtics nomirror
    set ytics nomirror
    if (kind eq 'components' || kind eq 'phase' || curves == 0) {
        unset logscale y
        set format y '%g'
        set key outside right top samplen 1.5 nobox
    } else {
        set logscale y
        set format y '10^{%L}'
        set key inside bottom right samplen 1.5 nobox
    }
    if (curves == 0) {
        unset xtics
        unset ytics
        set key inside bottom right
        plot [0:1] [-1:1] NaN title T[at + 1]
    }
    if (kind eq 'components') {
        plot for [c = 1:curves] datafile index k using 1:c+1 with lines lw 1.6 lc rgb colour(c) title T[at + c]
    }
    if (kind eq 'phase') {
        unset key
        set size ratio -1
        set offsets graph 0.04, graph 0.04, graph 0.04, graph 0.04
        plot datafile index k using 1:2 with lines lw 1.2 lc rgb colour(1)
        set size noratio
        unset offsets
    }
    if (kind eq 'invariants' && curves > 0) {
        plot for [c = 1:curves] datafile index k using 1:c+1 with lines lw 1.4 lc rgb colour(c) title T[at + c]
    }
    if ((kind eq 'manifold' || kind eq 'rounding') && curves > 0) {
        set yrange [1e-17:*]
        if (kind eq 'rounding') { set yrange [1e-17:1e-13] }
        plot datafile index k using 1:2 with points pt 7 ps 0.25 lc rgb colour(4) notitle
    }
    if (kind eq 'steps' && curves > 0) { plot datafile index k using 1:2 with linespoints lw 1.4 pt 7 ps 0.3 lc rgb colour(3) notitle }
    if (kind eq 'many steps' && curves > 0) { plot datafile index k using 1:2 with lines lw 1.4 lc rgb colour(3) notitle }
    at = at + (curves > 0 ? curves : 1)
}
unset multiplot
