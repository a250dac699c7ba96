int main(void) {
    return check(EXTRA_NAME, extra, golden_extra, EXTRAS) > 0;
}
