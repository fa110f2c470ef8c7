"""Events as columns of tables: HDF5, NumPy, MATLAB, Parquet and text."""
