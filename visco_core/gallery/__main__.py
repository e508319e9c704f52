"""Write the shipped sample scan again."""

from visco_core.gallery import make_sample_scan, sample_scan_path, write_scan

if __name__ == "__main__":
    write_scan(make_sample_scan(), sample_scan_path())
