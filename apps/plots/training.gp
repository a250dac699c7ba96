# The loss against the epoch. Columns, a line for each epoch: loss, loss of the validation part (NaN if there is none). T[1]: 1 with a validation
# part, else 0.
eval size(800, 500)
set title 'Training'
eval powers('y')
set xlabel 'epoch'
set ylabel 'loss (mean of an epoch)'
plot datafile index 1 using ($0 + 1):1 with lines lw 2 lc rgb '#1f5fa8' title 'training', \
    datafile index 1 using ($0 + 1):2 with lines lw 2 lc rgb '#d1641f' title V(1) > 0 ? 'validation' : ''
