# Points of the first two columns; with three or more columns also the first three in space, beside it.
# T[1]: columns, T[2]: classes; then the names of the columns, those of the classes. index 1 to T[2]: points of a class.
n = int(V(1))
m = int(V(2))
name(k) = T[2 + k]
class(c) = T[2 + n + c]
if (n > 2) { set multiplot layout 1,2 }
set xlabel name(1) noenhanced font small(name(1))
if (n > 1) { set ylabel name(2) noenhanced font small(name(2)) }
plot for [c = 1:m] datafile index c using 1:(n > 1 ? column(2) : 0) with points pt 7 ps 0.35 lc rgb colour(c) notitle, \
    for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced
if (n > 2) {
    set zlabel name(3) noenhanced font small(name(3)) rotate by 90
    set xyplane relative 0
    set view 62,38
    splot for [c = 1:m] datafile index c using 1:2:3 with points pt 7 ps 0.3 lc rgb colour(c) notitle, \
        for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced
    unset multiplot
}
