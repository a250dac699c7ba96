# The error of each method against its cost. T[1]: title, then the names of the methods. Block k: CPU time, evaluations and error of method k.
eval size(1100, 560)
label(panel) = panel == 1 ? 'CPU time [s]' : 'evaluations of the field'
set tics nomirror
eval powers('xy')
set key bottom left samplen 2 spacing 1.1 box lc rgb '#cccccc' opaque
set ylabel 'relative error at the end'
set multiplot layout 1,2 title T[1] noenhanced
do for [panel = 1:2] {
    set xlabel label(panel)
    plot for [k = 1:count - 1] datafile index k using panel:3 with linespoints lw 1.6 pt 5 + (k - 1) % 10 ps 0.6 lc rgb colour(k) \
        dt k > 10 ? 2 : 1 title T[1 + k] noenhanced
    unset key
    unset ylabel
}
