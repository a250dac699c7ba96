# The links of spherical pendulums, each on a unit sphere. T[1]: title, T[2]: number of links, T[3]: number of true trajectories, T[4]: of predicted ones.
# A block for each, the true ones first. Columns: for each link x, y, z and three more numbers.
links = V(2)
true = V(3)
all = V(3) + V(4)
style = true > 0 ? "points pt 7 ps 0.5" : "lines lw 1.5"
wide = links > 1 ? 520 : 700
columns = links < 3 ? links : 3
rows = int(links + 2) / 3
eval size(wide*columns, wide*rows + 30)
set multiplot layout rows, columns title T[1] noenhanced
set view equal xyz
set view 65,35,links > 1 ? 1.1 : 1.15
set key top left
set xyplane at -1
eval unit
set border 31
set xtics -1,1,1 offset 0,-0.3
set ytics -1,1,1 offset 0,-0.3
set ztics -1,1,1
set xlabel 'q_x' offset 0,-0.5
set ylabel 'q_y' offset 0,-0.5
set label 'q_z' at -1,-1,1.15 center
set arrow from 1,1,0.4 to 1,1,-0.4 lw 2.5 lc rgb '#333333' head filled front
set label 'gravity' at 1,1,0.55 center front
do for [link = 1:links] {
    x = 6*link - 5
    if (links > 1) { set title sprintf('link %d', link) }
    splot @sphere with lines lc rgb '#dcdcdc' lw 0.5 notitle, \
        for [k = 1:true] datafile index k using x:x+1:x+2 with lines lw 2 lc rgb '#1f5fa8' title k == 1 ? 'true' : '', \
        for [k = true+1:all] datafile index k using x:x+1:x+2 with @style lc rgb '#d1641f' title k == true+1 ? 'predicted' : ''
}
