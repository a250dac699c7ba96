# Points of three columns in space, with the plane w.x + b = 0 and its margins w.x + b = -1 and 1.
# T[1]: 3 columns, T[2]: classes; then the names of the columns, those of the classes; then for each of the axes x, y and z its
# column, its ends and its component of w; then b. index 1 to T[2]: points of a class.
m = int(V(2))
class(c) = T[5 + c]
at(axis, k) = V(1 + m + 4*axis + k)
name(axis) = T[2 + at(axis, 1)]
set xlabel name(1) noenhanced font small(name(1))
set ylabel name(2) noenhanced font small(name(2))
set zlabel name(3) noenhanced font small(name(3)) rotate by 90
set xrange [at(1, 2):at(1, 3)]
set yrange [at(2, 2):at(2, 3)]
set zrange [at(3, 2):at(3, 3)]
set xyplane relative 0
set view 62,38
set isosamples 14
set key top right
set lmargin at screen 0.1
plane(x, y, side) = (side - at(4, 1) - at(1, 4)*x - at(2, 4)*y)/at(3, 4)
cut(z) = z < at(3, 2) || z > at(3, 3) ? NaN : z
splot for [c = 1:m] datafile index c using (column(at(1, 1))):(column(at(2, 1))):(column(at(3, 1))) \
        with points pt 7 ps 0.3 lc rgb colour(c) notitle, \
    for [c = 1:m] keyentry with points pt 7 ps 0.8 lc rgb colour(c) title class(c) noenhanced, \
    cut(plane(x, y, 0)) with lines lc rgb '#333333' title 'plane', \
    cut(plane(x, y, 1)) with lines dt 3 lc rgb '#999999' title 'margin', \
    cut(plane(x, y, -1)) with lines dt 3 lc rgb '#999999' notitle
