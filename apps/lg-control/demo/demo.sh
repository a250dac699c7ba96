for file in swingup/swingup_test swingup/swingup.o; do # make writes these; foreign files stay
    [ ! -s $file ] || [ "$(head -c 4 $file | tr -d '\0')" = $'\177ELF' ] ||
        fail 3 "$file: exists and is not an earlier result of this kind: remove it, or write to another folder"
done
run lg-identify generate truth.yaml --excitation steps:0.4 --amplitude 8 --runs 4 --t-end 10 --dt 0.02 --start-spread 1 \
    --noise 1e-3,1e-2 --out log.csv
run lg-identify fit cart.yaml log.csv --out cart.h5
run lg-control train task.yaml --out policy.h5 --seconds "$LG_SECONDS" --seed "$LG_SEED"
result lg-control evaluate policy.h5 --plant truth.yaml
run lg-export policy.h5 --name swingup --out swingup
run make -B -f Makefile -C swingup test # what else is in the folder counts for nothing
