# Scatter plots of all pairs of columns, with each column's distribution on the diagonal; of one column, its distribution alone.
# T[1]: columns, T[2]: classes; then the names of the columns, those of the classes, and for each column the ends of its axis.
# index 1 to T[2]: points of a class. The others: a column's histogram (middle of a bin, then the fraction of each class in it).
n = int(V(1))
m = int(V(2))
name(k) = T[2 + k]
class(c) = T[2 + n + c]
low(k) = V(1 + n + m + 2*k)
high(k) = V(2 + n + m + 2*k)
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
        set xrange [low(k):high(k)]
        if (row == k) {
            set yrange [0:*]
            plot for [c = 1:m] datafile index m + k using 1:(column(1 + c)) \
                with filledcurves y1=0 fs transparent solid 0.45 lc rgb colour(c) title class(c) noenhanced
        } else {
            set yrange [low(row):high(row)]
            plot for [c = 1:m] datafile index c using k:row with points pt 7 ps 0.18 lc rgb colour(c) notitle
        }
    }
}
if (n > 1) { unset multiplot }
