# Some curves of a test set, true and learned, and the mean errors at each node. T[1]: title, T[2]: curves, T[3]: length of the beam.
# Index k: curve k. Columns: true x, y, learned x, y, true x', y', learned x', y'. The last block: s, error of q, error of v.
n = int(V(2))
eval size(1500, 520)
set multiplot layout 1, 3 title T[1] noenhanced
set key top center horizontal outside
set xlabel 'x'
set ylabel 'y'
set size ratio -1
set offsets graph 0.04, graph 0.04, graph 0.04, graph 0.04
do for [part = 0:1] {
    if (part == 1) {
        set xlabel "x'"
        set ylabel "y'"
        set xrange [-1.1:1.1]
        set yrange [-1.1:1.1]
        set offsets 0, 0, 0, 0
    }
    plot for [k = 1:n] datafile index k using 4 * part + 1:4 * part + 2 with lines lw 2 lc rgb '#1f5fa8' title (k == 1 ? 'true' : ''), \
        for [k = 1:n] datafile index k using 4 * part + 3:4 * part + 4 \
            with linespoints pt 7 ps 0.35 lw 0.7 lc rgb '#d1641f' title (k == 1 ? 'learned' : '')
}
set size noratio
set autoscale
set xrange [0:V(3)]
set xlabel 's'
set ylabel 'mean error'
eval powers('y')
plot datafile index n + 1 using 1:2 with lines lw 2 lc rgb '#2e8b57' title 'q', \
    datafile index n + 1 using 1:3 with lines lw 2 lc rgb '#8b3a8b' title "q'"
