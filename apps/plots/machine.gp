# Columns of a log against time, and what a model predicts and has learned: panels in rows.
# T[1]: title, T[2]: columns of the log, T[3]: 1 with bands, else 0; then for each column its name, and 1 if it is held between two rows,
# else 0. Then for each panel its kind and: columns: title, first column (from 1), number of columns, 1 if it is predicted, else 0;
# errors: number of errors, their names, empty if there is none; potential, friction: name of the coordinate, number of logged points.
# Columns: index 1: t, the log, its prediction, its standard deviations; for the errors a block of the horizon, the errors of the model, and
# those of a motion that stays as it is; for each term three blocks: its x, share of the rows; x, learned value; logged points.
C = int(V(2))
name(c) = T[2 + 2 * c]
held(c) = V(3 + 2 * c) > 0
length(at) = T[at] eq 'columns' ? 5 : T[at] eq 'errors' ? 2 + V(at + 1) : 3
panels = 0
at = 4 + 2 * C
while (at <= count) {
    panels = panels + 1
    at = int(at + length(at))
}
columns = panels < 3 ? panels : 3
rows = (panels + columns - 1) / columns
eval size(430 * columns, 290 * rows + 40)
strong(k) = word('#1f5fa8 #2c8a5a #8a4fa8 #a8871f #444444 #a83f5f #3fa0a8 #6b8a2c #5f5fa8', 1 + (k - 1) % 9)
pale(k) = word('#9fc2ea #a6d6bd #d3b6e2 #e2d39a #bbbbbb #e2a9b8 #a9dde2 #c9dba3 #b9b9e2', 1 + (k - 1) % 9)
thin(k) = n == 1 ? '#d1641f' : strong(k)
band(c, s) = column(c + 1 + C) + 2 * s * column(c + 1 + 2 * C)

set multiplot layout rows, columns title T[1] noenhanced
set key below center horizontal maxrows 2 noenhanced samplen 1.5 height 1
set offsets graph 0, graph 0, graph 0.12, graph 0.05
set lmargin 9

block = 2
at = 4 + 2 * C
do for [panel = 1:panels] {
    kind = T[at]
    if (kind eq 'columns') {
        a = int(V(at + 2)) - 1
        n = int(V(at + 3))
        predicted = V(at + 4) > 0
        bands = predicted && V(3) > 0
        set title T[at + 1] noenhanced
        set xlabel 't (s)'
        plot for [k = 1:n] datafile index 1 using 1:(bands ? band(a + k, -1) : NaN):(bands ? band(a + k, 1) : NaN) \
                with filledcurves fs transparent solid 0.3 noborder lc rgb thin(k) title '', \
            for [k = 1:n] datafile index 1 using 1:(held(a + k) ? NaN : column(a + k + 1)) \
                with lines lw (predicted ? 4 : 1.5) lc rgb (predicted ? pale(k) : strong(k)) title (held(a + k) ? '' : name(a + k)) noenhanced, \
            for [k = 1:n] datafile index 1 using 1:(held(a + k) ? column(a + k + 1) : NaN) \
                with steps lw 1.5 lc rgb strong(k) title (held(a + k) ? name(a + k) : '') noenhanced, \
            for [k = 1:n] datafile index 1 using 1:(predicted ? column(a + k + 1 + C) : NaN) \
                with lines lw 1.2 lc rgb thin(k) title (predicted && k == n ? 'predicted' : '')
    }
    if (kind eq 'errors') {
        set title 'error against horizon, root mean square'
        set xlabel 'horizon (s)'
        set logscale xy
        set format y '10^{%L}'
        set ytics 1e-12, 100
        plot for [e = 1:V(at + 1)] datafile index block using 1:(T[at + 1 + e] eq '' ? NaN : column(1 + e)) \
                with linespoints lw 1.8 pt 7 ps 0.4 lc rgb strong(e) title T[at + 1 + e], \
            for [e = 1:V(at + 1)] datafile index block using 1:(T[at + 1 + e] eq '' ? NaN : column(1 + V(at + 1) + e)) \
                with lines lw 2 dt 3 lc rgb pale(e) title '', \
            NaN with lines lw 2 dt 3 lc rgb pale(5) title 'unchanged (dotted)'
        unset logscale xy
        set format y
        set ytics autofreq
        block = block + 1
    }
    if (kind eq 'potential' || kind eq 'friction') {
        set y2range [0:6]
        potential = kind eq 'potential'
        set title (potential ? 'potential along '.T[at + 1].', from its least' : 'friction force on '.T[at + 1]) noenhanced
        set xlabel (potential ? '' : 'velocity of ').T[at + 1] noenhanced
        stats datafile index block + 1 using (finite(2, 1e300)) nooutput
        least = potential ? STATS_min : 0
        plot datafile index block using 1:2 axes x1y2 with boxes fs solid 1 noborder lc rgb '#c8d6c8' title 'rows of the log', \
            datafile index block + 2 using 1:2 with points pt 7 ps 0.35 lc rgb strong(1) title (V(at + 2) > 0 ? 'as logged' : ''), \
            datafile index block + 1 using 1:($2 - least) with lines lw 2 lc rgb '#d1641f' title 'learned'
        block = block + 3
    }
    at = int(at + length(at))
}
