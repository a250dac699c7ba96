# Points of classes. T[1]: columns, T[2]: classes; then the names of the columns, those of the classes, then what is drawn:
# pairs: all pairs of columns, with each column's distribution on the diagonal; of one column, its distribution alone;
# clouds: the first two columns; with three columns also all three in space, beside it;
# margin: three columns in space, with the plane w.x + b = 0 and its margins w.x + b = -1 and 1;
# plane: two columns and the line w.x + b = 0. Then b, and w if there is a plane or a line.
# Columns: class (1, 2, ...), number of earlier points of this class, then the columns.
n = int(V(1))
m = int(V(2))
kind = T[3 + n + m]
b = V(4 + n + m)
known = count > 4 + n + m
w(k) = V(4 + n + m + k)
name(k) = T[2 + k]
class(c) = T[2 + n + c]
label(axis, k) = sprintf('set %slabel name(%d) noenhanced font small(name(%d)); ', axis, k, k)
array low[n]
array high[n]
do for [k = 1:n] {
    stats datafile index 1 using 2 + k nooutput
    room = STATS_max > STATS_min ? 0.03*(STATS_max - STATS_min) : 0.5*abs(STATS_min) + 0.5
    low[k] = STATS_min - room
    high[k] = STATS_max + room
}
every = int(STATS_records/(kind eq 'pairs' ? 350 : kind eq 'margin' ? 1200 : 2400)) + 1
of(c) = column(1) == c && int(column(2)) % every == 0
x(k, c) = of(c) ? column(2 + k) : NaN
if (kind eq 'pairs') {
    eval size(n > 2 ? 150*n + 120 : 420, n > 2 ? 150*n + 120 : 420)
    array total[m]
    do for [c = 1:m] {
        stats datafile index 1 using (column(1) == c) nooutput
        total[c] = STATS_sum
    }
    if (n > 1) {
        set multiplot layout n,n margins 0.07,0.99,0.07,0.97 spacing 0.012
        set key samplen 1 font ',9'
        unset xtics
        unset ytics
    }
    do for [row = 1:n] {
        do for [k = 1:n] {
            if (row + k == 2) { set key } else { unset key }
            set xlabel (row == n ? name(k) : '') noenhanced font small(name(k))
            set ylabel (n == 1 ? 'part of the windows' : k == 1 ? name(row) : '') noenhanced font small(name(row))
            set xrange [low[k]:high[k]]
            if (row == k) {
                set yrange [0:*]
                half = (high[k] - low[k])/80 # of a bin: gnuplot's range of bins is from middle to middle
                plot for [c = 1:m] datafile index 1 using 2 + k:(column(1) == c ? 1.0/total[c] : 0) bins=40 binrange [low[k] + half:high[k] - half] \
                    with filledcurves y1=0 fs transparent solid 0.45 lc rgb colour(c) title class(c) noenhanced
            } else {
                set yrange [low[row]:high[row]]
                plot for [c = 1:m] datafile index 1 using (x(k, c)):(x(row, c)) with points pt 7 ps 0.18 lc rgb colour(c) notitle
            }
        }
    }
}
if (kind eq 'clouds') {
    eval size(n > 2 ? 1240 : 720, 600)
    if (n > 2) { set multiplot layout 1,2 }
    set xlabel name(1) noenhanced font small(name(1))
    if (n > 1) { set ylabel name(2) noenhanced font small(name(2)) }
    plot for [c = 1:m] datafile index 1 using (x(1, c)):(n > 1 ? x(2, c) : 0) with points pt 7 ps 0.35 lc rgb colour(c) notitle, \
        for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced
    if (n > 2) {
        set zlabel name(3) noenhanced font small(name(3)) rotate by 90
        set xyplane relative 0
        set view 62,38
        splot for [c = 1:m] datafile index 1 using (x(1, c)):(x(2, c)):(x(3, c)) with points pt 7 ps 0.3 lc rgb colour(c) notitle, \
            for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced
    }
}
if (kind eq 'margin') {
    eval size(900, 720)
    # Upright is the column in which the plane's normal is longest, in lengths of the axes: the plane's equation is solved for it.
    normal(k) = abs(w(k))*(high[k] - low[k])
    r = normal(1) > normal(3) ? 1 : 3
    r = normal(2) > normal(r) ? 2 : r
    p = r == 1 ? 2 : 1
    q = r == 3 ? 2 : 3
    eval label('x', p).label('y', q)
    set zlabel name(r) noenhanced font small(name(r)) rotate by 90
    set xrange [low[p]:high[p]]
    set yrange [low[q]:high[q]]
    set zrange [low[r]:high[r]]
    set xyplane relative 0
    set view 62,38
    set isosamples 14
    set key top right
    set lmargin at screen 0.1
    cut(z) = z < low[r] || z > high[r] ? NaN : z
    plane(u, v, side) = w(r) == 0 ? NaN : cut((side - b - w(p)*u - w(q)*v)/w(r))
    splot for [c = 1:m] datafile index 1 using (x(p, c)):(x(q, c)):(x(r, c)) with points pt 7 ps 0.3 lc rgb colour(c) notitle, \
        for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced, \
        plane(x, y, 0) with lines lc rgb '#333333' title 'plane', \
        plane(x, y, 1) with lines dt 3 lc rgb '#999999' title 'margin', \
        plane(x, y, -1) with lines dt 3 lc rgb '#999999' notitle
}
if (kind eq 'plane') {
    eval size(760, 600)
    eval label('x', 1).label('y', 2)
    set xrange [low[1]:high[1]]
    set yrange [low[2]:high[2]]
    set clip two
    set samples 2
    # The line from its point nearest to the origin, far in both directions.
    norm = known ? sqrt(w(1)**2 + w(2)**2) : 1
    # The range of x is sampled at its two ends.
    far = 2*(high[1] - low[1] + high[2] - low[2] + abs(b)/norm)
    at(u) = far*(2*(u - low[1])/(high[1] - low[1]) - 1)
    plot for [c = 1:m] datafile index 1 using (x(1, c)):(x(2, c)) with points pt 7 ps 0.4 lc rgb colour(c) notitle, \
        for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced, \
        for [k = 1:known] '+' using (-(b*w(1)/norm + at($1)*w(2))/norm):(-(b*w(2)/norm - at($1)*w(1))/norm) \
            with lines lw 1.5 lc rgb '#333333' title 'decision'
}
