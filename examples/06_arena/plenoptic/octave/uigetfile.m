function [file, path] = uigetfile(varargin)
  % Every file of the task that fits, as if a user had marked all of them.
  path = [getenv('ARENA_TASK') '/'];
  pattern = varargin{1};
  if iscell(pattern), pattern = pattern{1}; end
  file = {};
  for part = strsplit(pattern, ';')
    found = dir([path part{1}]);
    file = [file, {found.name}];
  end
end
