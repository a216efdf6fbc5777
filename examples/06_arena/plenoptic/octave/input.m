function value = input(varargin)
  value = str2double(getenv('ARENA_INPUT'));
end
