# ROC curves. T[1], T[2], ...: their titles. index 1, 2, ...: a curve (false positive rate, true positive rate).
eval size(640, 600)
set xlabel 'false positive rate'
set ylabel 'true positive rate'
set xrange [0:1]
set yrange [0:1.01]
set size square
set key bottom right
plot x with lines dt 3 lc rgb '#999999' notitle, \
    for [k = 1:count] datafile index k using 1:2 with lines lw 2 lc rgb colour(k) title T[k] noenhanced
