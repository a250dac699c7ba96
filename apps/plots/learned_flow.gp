# Trajectories. T[1]: title, T[2]: size d of a state, T[3]: number of true trajectories, T[4]: of predicted ones. A block for each, the true ones first.
# Columns: the state, t. For one degree of freedom the phase portrait and q and p against t are drawn, otherwise q_2 against q_1.
phase = V(2) == 2
panels = phase ? 3 : 1
true = V(3)
all = V(3) + V(4)
eval size(phase ? 3*520 : 700, (phase ? 520 : 700) + 30)
set multiplot layout 1,panels title T[1] noenhanced
set key below center horizontal
set bmargin 5
set autoscale xfix
set offsets graph 0.03, graph 0.03, graph 0.03, graph 0.03
set size ratio -1
do for [panel = 1:panels] {
    set xlabel panel > 1 ? 't (s)' : phase ? 'q' : 'q_1'
    set ylabel panel == 3 ? 'p' : panel == 2 ? 'q' : phase ? 'p' : 'q_2'
    if (panel > 1) { set size noratio }
    x = panel > 1 ? 3 : 1
    y = panel == 2 ? 1 : 2
    if (true > 0) {
        plot for [k = 1:true] datafile index k using x:y with lines lw 2 lc rgb '#1f5fa8' title k == 1 ? 'true' : '', \
            for [k = true+1:all] datafile index k using x:y with points pt 7 ps 0.5 lc rgb '#d1641f' title k == true+1 ? 'predicted' : ''
    } else {
        plot for [k = 1:all] datafile index k using x:y with lines lw 1.5 lc rgb '#d1641f' title k == 1 ? 'predicted' : ''
    }
}
