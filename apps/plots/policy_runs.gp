# Runs of a controller: the motion of some, the starts of all, each input of some.
# For each panel: title, label of x, label of y, legend of failed runs, legend of successful runs; then two numbers: x and y of the
# goal, of an input its limits. Columns: x, y. Index 2 p - 1: failed runs of panel p, 2 p: successful ones. A block may be NaN.
panel(p, k) = 7 * (p - 1) + k
panels = count / 7
rows = (panels + 2) / 3
eval size(3 * 460, rows * 380)
set multiplot layout rows, 3
set key below center horizontal noenhanced samplen 1.5
set autoscale fix
set lmargin 9
set bmargin 6
set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05
do for [p = 1:panels] {
    set title T[panel(p, 1)] noenhanced
    set xlabel T[panel(p, 2)] noenhanced
    set ylabel T[panel(p, 3)] noenhanced
    if (p == 1) {
        plot datafile index 2 using 1:2 with lines lw 1 lc rgb '#7fa9d8' title T[panel(p, 5)], \
            datafile index 1 using 1:2 with lines lw 1 lc rgb '#d1641f' title T[panel(p, 4)], \
            '+' using (V(panel(p, 6))):(V(panel(p, 7))) every ::0::0 with points pt 7 ps 0.9 lc rgb '#000000' title 'goal'
    }
    if (p == 2) {
        plot datafile index 4 using 1:2 with points pt 7 ps 0.4 lc rgb '#1f5fa8' title T[panel(p, 5)], \
            datafile index 3 using 1:2 with points pt 2 ps 0.8 lc rgb '#d1641f' title T[panel(p, 4)]
    }
    if (p > 2) {
        plot datafile index 2 * p using 1:2 with steps lw 1.2 lc rgb '#7fa9d8' title T[panel(p, 5)], \
            datafile index 2 * p - 1 using 1:2 with steps lw 1.2 lc rgb '#d1641f' title T[panel(p, 4)], \
            V(panel(p, 6)) with lines lw 1.5 dt 2 lc rgb '#555555' title '', \
            V(panel(p, 7)) with lines lw 1.5 dt 2 lc rgb '#555555' title 'limits'
    }
}
