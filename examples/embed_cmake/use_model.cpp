// use_model_cpp MODEL.h5: uses the library from C++. A class owns the model file and the work memory.
#include <cmath>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <liegrad/model.h>

// Owns the loaded file, so that it is closed even if the constructor of Model below throws.
class File {
  public:
    explicit File(const std::string &path) {
        lg_error error;
        if (lg_model_load(nullptr, path.c_str(), nullptr, &file_, &error) != LG_OK)
            throw std::runtime_error(error.message);
    }
    ~File() {
        lg_model_file_destroy(&file_);
    }
    File(const File &) = delete;
    File &operator=(const File &) = delete;
    const lg_model *model() const {
        return file_.model;
    }

  private:
    lg_model_file file_;
};

class Model {
  public:
    explicit Model(const std::string &path) : file_(path), room_(lg_model_work_size(file_.model()) + 64) {
        void *at = room_.data();
        std::size_t space = room_.size();
        work_ = std::align(64, space - 64, at, space);
    }
    Model(const Model &) = delete;
    Model &operator=(const Model &) = delete;

    std::size_t inputs() const {
        return lg_model_inputs(file_.model());
    }
    std::size_t outputs() const {
        return lg_model_outputs(file_.model());
    }
    // x has inputs() numbers, y has outputs() numbers. Does not allocate memory.
    void eval(const std::vector<double> &x, std::vector<double> &y) {
        if (x.size() != inputs() || y.size() != outputs()) throw std::invalid_argument("sizes of eval");
        lg_model_eval(file_.model(), x.data(), y.data(), work_);
    }

  private:
    File file_;
    std::vector<unsigned char> room_;
    void *work_;
};

int main(int argc, char **argv) {
    if (argc != 2) {
        std::cerr << "usage: use_model_cpp MODEL.h5\n";
        return 2;
    }
    try {
        Model model(argv[1]);
        std::vector<double> x(model.inputs(), 0.25), y(model.outputs());
        model.eval(x, y);
        std::cout << "first of " << y.size() << " outputs: " << y[0] << "\n";
        return std::isfinite(y[0]) ? 0 : 1;
    } catch (const std::exception &failure) {
        std::cerr << failure.what() << "\n";
        return 3;
    }
}
