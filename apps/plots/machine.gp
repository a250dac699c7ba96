# Columns of a log against time, and what a model predicts and has learned: panels in rows.
# T[1]: title, T[2], T[3]: rows and columns of panels, T[4]: columns of the log, T[5]: groups of columns, T[6]: 1 with bands, else 0,
# T[7]: curves of the errors, T[8]: learned terms. Then follow the names of the columns; for each column 1 if it is held between two rows,
# else 0; for each group title, first column (from 1), number of columns, 1 if it is predicted, else 0; the name of each error, empty if
# there is none; for each learned term title, label of x, number of logged points.
# Columns: index 1: t, the log, its prediction, its standard deviations; 2: horizon, and for each error those of the model and of a motion
# that stays as it is; for term k 3 k: its x, share of the rows; 3 k + 1: x, learned value; 3 k + 2: logged points. A block may be NaN.
C = V(4)
name(c) = T[8 + c]
held(c) = V(8 + C + c) > 0
group(i, k) = 8 + 2 * C + 4 * (i - 1) + k
errors = 8 + 2 * C + 4 * V(5)
term(i, k) = errors + V(7) + 3 * (i - 1) + k
strong(k) = word('#1f5fa8 #2c8a5a #8a4fa8 #a8871f #444444 #a83f5f #3fa0a8 #6b8a2c #5f5fa8', 1 + (k - 1) % 9)
pale(k) = word('#9fc2ea #a6d6bd #d3b6e2 #e2d39a #bbbbbb #e2a9b8 #a9dde2 #c9dba3 #b9b9e2', 1 + (k - 1) % 9)
thin(k) = n == 1 ? '#d1641f' : strong(k)
band(c, s) = column(c + 1 + C) + 2 * s * column(c + 1 + 2 * C)

set multiplot layout V(2), V(3) title T[1] noenhanced
set key below center horizontal maxrows 2 noenhanced samplen 1.5 height 1
set offsets graph 0, graph 0, graph 0.12, graph 0.05
set lmargin 9

set xlabel 't (s)'
do for [i = 1:V(5)] {
    a = int(V(group(i, 2))) - 1
    n = int(V(group(i, 3)))
    predicted = V(group(i, 4)) > 0
    bands = predicted && V(6) > 0
    set title T[group(i, 1)] noenhanced
    plot for [k = 1:n] datafile index 1 using 1:(bands ? band(a + k, -1) : NaN):(bands ? band(a + k, 1) : NaN) \
            with filledcurves fs transparent solid 0.3 noborder lc rgb thin(k) title '', \
        for [k = 1:n] datafile index 1 using 1:(held(a + k) ? NaN : column(a + k + 1)) \
            with lines lw (predicted ? 4 : 1.5) lc rgb (predicted ? pale(k) : strong(k)) title (held(a + k) ? '' : name(a + k)) noenhanced, \
        for [k = 1:n] datafile index 1 using 1:(held(a + k) ? column(a + k + 1) : NaN) \
            with steps lw 1.5 lc rgb strong(k) title (held(a + k) ? name(a + k) : '') noenhanced, \
        for [k = 1:n] datafile index 1 using 1:(predicted ? column(a + k + 1 + C) : NaN) \
            with lines lw 1.2 lc rgb thin(k) title (predicted && k == n ? 'predicted' : '')
}

if (V(7) > 0) {
    set title 'error against horizon, root mean square'
    set xlabel 'horizon (s)'
    set logscale xy
    set format y '10^{%L}'
    set ytics 1e-12, 100
    plot for [e = 1:V(7)] datafile index 2 using 1:(T[errors + e] eq '' ? NaN : column(2 * e)) \
            with linespoints lw 1.8 pt 7 ps 0.4 lc rgb strong(e) title T[errors + e], \
        for [e = 1:V(7)] datafile index 2 using 1:(T[errors + e] eq '' ? NaN : column(2 * e + 1)) \
            with lines lw 2 dt 3 lc rgb pale(e) title '', \
        NaN with lines lw 2 dt 3 lc rgb pale(5) title 'unchanged (dotted)'
    unset logscale xy
    set format y
    set ytics autofreq
}

set y2range [0:6]
do for [i = 1:V(8)] {
    set title T[term(i, 1)] noenhanced
    set xlabel T[term(i, 2)] noenhanced
    plot datafile index 3 * i using 1:2 axes x1y2 with boxes fs solid 1 noborder lc rgb '#c8d6c8' title 'rows of the log', \
        datafile index 3 * i + 2 using 1:2 with points pt 7 ps 0.35 lc rgb strong(1) title (V(term(i, 3)) > 0 ? 'as logged' : ''), \
        datafile index 3 * i + 1 using 1:2 with lines lw 2 lc rgb '#d1641f' title 'learned'
}
unset multiplot
