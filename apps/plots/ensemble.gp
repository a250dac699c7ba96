# Bands of quantiles over time, and histograms of the times of events. T[1]: number of panels with bands, T[2]: number of all panels, then the title of each.
# Block k is panel k. Columns: t and the quantiles .01, .05, .25, .5, .75, .95, .99; or t and how many.
set tics nomirror
set key below
rows = int(V(2) + 1) / 2
eval size(V(2) > 1 ? 1120 : 560, 340*rows)
set multiplot layout rows, V(2) > 1 ? 2 : 1
set xlabel 't [s]'
do for [k = 1:V(2)] {
    set title T[2 + k] noenhanced
    if (k <= V(1)) {
        plot datafile index k using 1:2:8 with filledcurves lc rgb '#dbe7f4' title '1-99 %', \
            datafile index k using 1:3:7 with filledcurves lc rgb '#b3cde6' title '5-95 %', \
            datafile index k using 1:4:6 with filledcurves lc rgb '#7fa8d1' title '25-75 %', \
            datafile index k using 1:5 with lines lw 1.6 lc rgb '#1f5fa8' title 'median'
    } else {
        plot datafile index k using 1:2 with boxes fs solid 0.6 lc rgb '#d1641f' notitle
    }
    unset key # only the first panel has one
}
